"""What people run: the command line, scenes, reports and figures.

In: the name of a scene or a scene file. Out: what the run printed, as results.json, tables, figures and VTU in one folder.
What is public comes through the front door, `from femsub import ...`, as for every user.
"""
