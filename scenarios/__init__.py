"""Data only: rigs, references, pressure conditions and demonstrations. Found by ``pneuid.resources.scenario_path``."""
