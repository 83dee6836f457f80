"""All use of the operating system: work beside this process, memory, threads, folders of one run.

`beside` does work while this process goes on: `divided` by a fork, which shares its memory, `Process` by a new interpreter.
`parts` maps a function over parts by several worker processes. `memory` returns how many bytes are available. `limits` has the
sizes from which each of these pays. In: functions and arrays. Out: their results.
"""
