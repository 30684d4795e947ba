"""The procedure of the 2011 study on bench runs: steady curves, pre-sliding slope, pressure laws, and the joint fit beside it.

Source: Liu, Chen, Tao, "Parameters identification and analysis of pneumatic cylinders friction model based on
experiments", Proc. 8th JFPS Int. Symposium on Fluid Power, Okinawa 2011, paper 1D1-2; equation numbers are its own.
"""
