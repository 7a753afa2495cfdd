"""Whether steps are short enough: stability limits, and the fastest motion of a System.

Imports the families whose limits it knows. The run uses it for warnings.
"""
