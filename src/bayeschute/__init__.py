"""bayeschute: probabilistic identification of parachute clusters from flight records."""

__version__ = "0.1.0"
