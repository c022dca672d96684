"""The Tektronix twins held against the manufacturer's own descriptions of both families."""
