"""The panel: a page in a browser that shows a running kernel, plans, executes, jogs and stops.

``arm``, ``shapes``, ``clearance``, ``inverse``, ``settings`` and ``scope`` need numpy only;
``planning`` needs OMPL, the rest viser (extra ``panel``). Each browser is a view; one of them may
lead. Never here: what a kernel decides.
"""
