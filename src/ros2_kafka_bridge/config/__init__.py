"""The configuration: settings classes, the file they are read from, and what its mistakes say."""
