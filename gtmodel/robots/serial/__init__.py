"""Serial arms with any number of joints, from Denavit-Hartenberg parameters and from URDF files, and back."""
