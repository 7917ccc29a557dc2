"""Orders both ways while things break at random from a seed, and the proof that none is lost."""
