"""Reduced models of a cluster: pendulum, planar dumbbell, flyout, maypole and breathing."""
