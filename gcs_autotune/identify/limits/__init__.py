"""What runs can and cannot tell, which manoeuvre to fly next, and which structure they justify.

================  ===================================================================================
subject           a fit on its runs, seen as a coupled model whatever its kind
information       Fisher information with initial states marginalised; Cramer-Rao bounds for any fit
scales            how much of a parameter would be felt: what makes a standard error large
reach             how fast, how far and how much turning: of runs flown and of runs proposed
identifiability   parameters that move together, parameters the runs hardly see
likelihood        profile likelihood of one parameter: an interval that is honest where it is not closed
helm              the form's inputs as thrust and steering, within what the runs have used
manoeuvres        the table of manoeuvres that can be proposed
next_manoeuvre    the manoeuvres ranked by what they would add
structure_choice  coupled forms weighed by information criteria and errors on data left out
axis_choice       the same for the drag of one degree of freedom, beside Miskovic2010, eq. (7.1)-(7.2)
words, pictures   the same in sentences and in figures
================  ===================================================================================
"""
