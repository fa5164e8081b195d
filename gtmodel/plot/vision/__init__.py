"""Pictures of what cameras measure."""
