"""From a JAX function of small arrays to sparse derivatives and machine code; independent of parachutes."""
