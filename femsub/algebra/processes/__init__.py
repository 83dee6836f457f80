"""All use of the operating system: work beside this process, memory, threads, folders of one run.

Two verbs. `beside` does work while this process goes on: `divided` by a fork with its memory, `Process` by a new interpreter.
`parts` maps a function over parts with workers. Callers ask `memory` how many bytes are left. `limits` says from where each pays.
In: functions and arrays. Out: their results.
"""
