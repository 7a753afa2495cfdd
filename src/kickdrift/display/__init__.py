"""Objects as people see them: text, HTML, progress bars."""
