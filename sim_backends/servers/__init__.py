"""The virtual instruments' network side: one loop, raw sockets and HiSLIP."""
