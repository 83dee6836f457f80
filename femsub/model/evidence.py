"""One word for each quality of evidence that none of the eigenvalues asked for is missing."""

#: By an argument without sampling: the inertia of K - ω²M, or all eigenvalues were computed, and their number is known.
CERTIFIED = "certified"
#: By a function sampled on a contour, whose phase or margin is not bounded between the points: a winding number of det P, or
#: the count in a disc where contacts and dashpots come in by a small determinant.
CONFIRMED = "confirmed"
#: The eigensolver's word alone.
NOT_CHECKED = "not checked"
