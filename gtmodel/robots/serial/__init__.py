"""Serial arms of any number of joints: by Denavit-Hartenberg numbers, from URDF files and back to them."""
