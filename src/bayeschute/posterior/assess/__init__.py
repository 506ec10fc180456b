"""Assessment of a posterior: profile likelihood, score tests, multistart, identifiability, exact importance weights."""
