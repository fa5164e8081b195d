"""Rotations, quaternions (scalar first) and poses, each once: for rows of NumPy, CasADi columns and expressions alike.

entries       vectors and matrices of all three, entry by entry
rotations     cross matrices, turns about axes and by rotation vectors, their derivatives, nearest rotations, ZYZ,
              roll pitch yaw; poses, a quaternion and a translation in seven numbers
quaternions   product, conjugate, matrix and back, logarithm and exponential, small turns
expressions   turned vectors, velocity and rates of quaternions, in the language
"""
