"""Error estimates of parts and of systems, and the number of modes that a tolerance requires.

In: the factor and the static shapes of each part. Out: the modes that are kept, and the `Estimate` of the model made of them.

The files:

- `found_modes`: the modes of a part found so far, and its static shapes. Modes are added, never computed again.
- `nested`: the reference. It contains the reduced models with any number of modes. It estimates their differences from the
  reference, and the reference's own error against the full model.
- `search`: the reference of one part (`Space`), and the fewest modes that meet the tolerance. More modes are computed if none do.
- `joined`: the reference of joined parts (`JoinedSpace`), and the estimate of a system whose parts are reduced already.
- `leaving_out`: rejects smaller models without solving them.

With friction, the basis consists of eigenvectors of the system itself, see `femsub.reduction.vectors`.
"""
