"""What the modules say to each other, as JSON: the words of VDA 5050 where it has one.

Every message that holds a state is a snapshot: the whole state of its module, which the next one
replaces. Whoever starts later, or again, needs only the newest. `step` is the step of the fleet
(`FleetState.step`) that a snapshot reflects.

Cells are (column, row), counted from 0 at the top left; one cell is one metre, unless the site
says otherwise. Times that end in `_s` are seconds since the epoch, or since the start of a
simulation. JSON spells fields in camel case.
"""
