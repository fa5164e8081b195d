"""Pictures of lead-through: forces, paths, energy at the handle, a peg in its hole, limits."""
