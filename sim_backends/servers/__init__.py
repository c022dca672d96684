"""The virtual instruments' network side: one loop, raw sockets, HiSLIP and VXI-11."""
