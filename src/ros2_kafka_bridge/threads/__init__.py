"""How what runs is told to pause, to stop and to begin again, and threads that nobody waits for.

Nothing of what runs in them: no room of the bridge is imported.
"""
