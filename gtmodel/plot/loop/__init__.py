"""Pictures of the loop: a tool that is led by hand."""
