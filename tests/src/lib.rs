//! End-to-end tests: see `tests/it`. The library is empty; the binaries are what the tests start.
