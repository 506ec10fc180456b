"""From the tables of a study to models, data and priors."""
