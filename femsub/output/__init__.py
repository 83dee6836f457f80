"""How results show themselves: tables and charts as values, figures, units. It knows no model.

In: rows, points and labels. Out: text, HTML, data frames and figures of matplotlib, from one definition of each table and chart.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
