"""Controllers of pneumatic servos, built from an identified model. Imports ``pneuid``, never the reverse."""
