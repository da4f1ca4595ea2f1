"""Identification in the frequency domain.

============  ===================================================================================
response      the empirical response: frequencies, complex gains, coherence, uncertainty
spectrum      the response of any run (cross spectra with sine tapers) or of a relay (harmonics)
nomoto        fits of Nomoto's models of first and second order to the response
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
