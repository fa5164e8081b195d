"""Rotations, quaternions (scalar first) and poses, for NumPy rows, CasADi columns and expressions of the language.

entries       vectors and matrices of all three types, entry by entry
rotations     cross matrices, rotations about axes and by rotation vectors, their derivatives, nearest rotations, ZYZ,
              roll pitch yaw; poses, a quaternion and a translation in seven numbers
quaternions   product, conjugate, conversion to and from matrices, logarithm and exponential, small rotations
chains        serial chains as lines in space: closed forms found from the axes, all postures of a pose
expressions   rotated vectors, angular velocity and rates of quaternions, in the language
"""
