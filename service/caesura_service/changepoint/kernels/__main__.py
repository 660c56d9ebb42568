"""`python -m caesura_service.changepoint.kernels`: compile, so that no session has to wait for it."""

from __future__ import annotations

import time

from caesura_service.changepoint.compiled import compile_now
from caesura_service.changepoint.kernels.compiling import cache_directory

before = time.perf_counter()
compile_now()
print(f"kernels ready in {time.perf_counter() - before:.1f} s, kept in {cache_directory().parent}")
