"""What a posterior says of canopies in the formats of other programs: the cluster as one body, JSBSim, RocketPy."""
