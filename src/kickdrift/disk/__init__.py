"""Files on the disk: opened, made, told apart and replaced without harm. Knows nothing of what they hold."""
