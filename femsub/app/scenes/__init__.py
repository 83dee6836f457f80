"""Built-in scenes: frozen classes whose fields are the keys of a scene file, each with a method `run`."""
