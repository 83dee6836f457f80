"""Where friction takes the stability away. In: a model and a port. Out: the critical slope, and growth rates over the slope."""
