"""The program for users: command line, scenes, reports and figures.

In: the name of a scene or a scene file. Out: the printed results, as results.json, tables, figures and VTU in one folder.
Public names are imported through the front door, `from femsub import ...`, as a user does.
"""
