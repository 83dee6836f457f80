"""Error estimates, and how many modes a tolerance takes: of parts and of systems.

In: the factor and the static shapes of each part. Out: the modes that are kept, and the `Estimate` of the model made of them.

Each estimate takes four things, one file each:

- `found_modes`: the modes of a part that are found so far, and its static shapes. More are added, none computed again.
- `nested`: the reference. It contains the reduced models of all numbers of modes, and shows how far each is from it, and how far
  it may itself be from the full model.
- `space` and `joined`: the reference of one part, and of parts that are joined.
- `search`: the fewest modes that meet the tolerance, or more modes if none do.

Under friction the vectors of the system itself are the basis, see `femsub.reduction.vectors`.
"""
