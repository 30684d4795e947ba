"""The browser workbench: the loop of fit, compare, diagnose and add, by eye and hand (``python -m pneuid.workbench``).

Three processes: the one that serves the page draws and computes nothing heavy; one reads recordings; one fits, compares
and diagnoses, and is the one that ``Cancel`` may end. A project is a folder that the commands read and write too.
"""
