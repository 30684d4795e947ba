"""The identified model and its controllers for a target: C99, FMI 2.0, python-control."""

from controllers.export.io_system import linearised, operating_point, to_control

__all__ = ["linearised", "operating_point", "to_control"]
