"""From the words of a study to models, data and priors."""
