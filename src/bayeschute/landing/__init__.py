"""Landings: from a drawn start through drawn winds to the ground, and the decisions that follow from them."""
