"""bayeschute: probabilistic identification of parachute clusters from flight records."""

__version__ = "0.2.0"
