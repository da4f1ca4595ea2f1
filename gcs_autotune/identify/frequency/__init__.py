"""Frequency domain: what control people look at first.

============  ===================================================================================
response      the empirical response as a value: frequencies, complex gains, coherence, uncertainty
spectrum      it, from any run: cross spectra with sine tapers; from a relay: the harmonics of its cycles
nomoto        Nomoto's models of first and second order fitted to it
by_frequency  the method ``frequency``
============  ===================================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.frequency.response import COHERENT, FrequencyResponse
from gcs_autotune.identify.frequency.spectrum import harmonic_response

__all__ = [
    "COHERENT",
    "FrequencyResponse",
    "harmonic_response",
]
