"""Contacts: belts and friction laws, friction between surfaces, and their forces in motion.

In: ports or surfaces of a model. Out: small matrices on port columns, and forces f(u, v) with their derivatives.
"""
