"""A scan and a target in, a `Registration` out; `dqreg.registration.batch` does many of them in worker processes."""
