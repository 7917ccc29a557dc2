"""What is said to people: lines of the log, repeated ones summed, and text that is safe to show.

It is given the words, and imports nothing of the bridge but its errors.
"""
