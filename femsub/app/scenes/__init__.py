"""Built-in scenes: each module holds a frozen `SCENE` (its keys are those of a scene file) and `run`."""
