"""Pictures of learning control: error by iteration, what Q lets through, the tool's path."""
