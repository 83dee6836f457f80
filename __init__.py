"""`import femsub` from the folder above a clone finds this folder, called like the package in it: it hands over to that."""

if __name__ == "femsub":
    from pathlib import Path

    _inner = Path(__file__).parent / "femsub"
    __path__ = [str(_inner)]
    __file__ = str(_inner / "__init__.py")
    if __spec__ is not None:
        __spec__.submodule_search_locations = __path__
    exec(compile((_inner / "__init__.py").read_text(encoding="utf-8"), __file__, "exec"))
