"""Above the workers of a bridge: starting, reloading, pausing and draining them, as one."""
