"""What the data tell and what they do not: profiles, score tests, several starts, exact weights."""
