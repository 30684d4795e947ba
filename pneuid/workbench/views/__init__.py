"""The views of the workbench, one a file: each draws what the project and the jobs hold, and computes nothing."""
