"""Kinematics that the equations alone do not give: workspaces and accuracies."""
