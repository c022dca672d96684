"""The simulated bench: virtual instruments on real sockets that share one physical world."""
