"""`check`: what a configuration would meet, before it does."""
