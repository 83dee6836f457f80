"""How results are shown: tables, charts and verdicts as values, a run's result and page, figures, units. It knows no model.

In: rows, points, labels and sentences. Out: text, HTML, files, data frames and figures, all from one definition.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
