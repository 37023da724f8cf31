"""One small file a task; a new file here is a new task."""
