"""Reduced models: one file for each method.

In: a `Substructure`. Out: a `ReducedSubstructure`, which is a `Substructure` again.
"""

from femsub.reduction.reduce import METHODS as METHODS, PORT_LIMIT as PORT_LIMIT, Method as Method
