"""How what runs is told to pause, to stop and to begin again; nothing of what it does."""
