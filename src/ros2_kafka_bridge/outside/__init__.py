"""What strangers have a hand in: files that a setting names, addresses that hold secrets.

It imports nothing of the bridge, and may be used by all of it.
"""
