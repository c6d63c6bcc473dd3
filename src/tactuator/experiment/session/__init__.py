"""A visit of a subject: tasks, trials in order, the apparatus and the clock."""
