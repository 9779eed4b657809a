"""What the head can be busy with: each activity is a plain value with one answer to everything it can be told."""
