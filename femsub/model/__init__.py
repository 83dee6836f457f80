"""What a component is: matrices, DOF, ports, friction, and the pencil λ²M + λD + K.

In: arrays and numbers. Out: checked, frozen objects.
"""
