"""The base balances, one a file: gas, valve, chamber, friction, motion.

Every function takes floats or CasADi symbols alike.
"""
