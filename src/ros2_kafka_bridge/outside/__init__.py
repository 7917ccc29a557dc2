"""What lies outside: files that a setting names, secrets in addresses, libraries of extras.

It imports nothing of the bridge, and may be used by all of it.
"""
