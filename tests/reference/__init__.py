"""Slow, independent truths that texsss is held against; nothing here imports texsss.

    layers      the stack that all references take
    boundary    Fresnel reflectance and its moments
    montecarlo  photons through the stack: any phase function, per-layer eta, error bars
    adding      adding-doubling (iadpython): totals to five digits
    collocation spectral solution of layered boundary-value problems
    beam        collimated light in the stack, the source of the three below
    diffusion   its use for N-layer diffusion, the twin of `layered-diffusion`
    sp3         its use for the two-mode model, the twin of `layered-sp3`'s R_c
    four_streams  discrete ordinates of two cosines per hemisphere, the twin of `four_streams.lacking`
    even        light that is everywhere alike in a thin slab, the twin of `even`
    multipole   sources and sinks of one slab, the twin of `multipole`
    plate       random walks through a plate that is thicker in one place than in another
    transport   tabulated solutions of the integral transport equation
    stacks      the stacks of the accuracy table and their tabulated Monte Carlo results

Reflectances and transmittances are per unit of light that entered, lengths mm, coefficients 1/mm,
eta = inside / outside.
"""
