"""Pictures of filters: errors, innovations, what they bridge."""
