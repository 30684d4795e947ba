"""The truth's equations and their integrator, compiled, one physics a file.

States and parameters are the flat arrays of ``layout``. Everything here is written without
smoothing: the sign of the velocity, the valve opening, the metering edges, the ISO 6358 flow
(with the laminar patch above a pressure ratio of 0.999 that the contract fixes) and the stops.

Sources: Canudas de Wit et al. 1995 (LuGre); ISO 6358-1:2013 eq. 3 to 5; Strang 1968.
"""

from pneuid.virtual_rig.kernel.friction import friction_coefficients, friction_of, stribeck
from pneuid.virtual_rig.kernel.motion import advance
from pneuid.virtual_rig.kernel.runs import rounded, run_closed_loop, run_commands, run_imposed

__all__ = [
    "advance", "friction_coefficients", "friction_of", "rounded", "run_closed_loop", "run_commands", "run_imposed", "stribeck",
]  # fmt: skip
