"""What can break, a file for each: how it is done and undone, and what that may cost.

`inject` breaks something, `recover` mends it and tells when the broken thing was back. What is
aimed at one of several is chosen by a number of the plan, so that a seed repeats it.
"""
