"""What a component is: matrices, DOF, ports, the pencil λ²M + λD + K, and what a contact must be able to do.

In: arrays and numbers. Out: checked, frozen objects.
"""
