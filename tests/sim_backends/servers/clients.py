"""Clients nobody here wrote."""

import pyvisa
from pyvisa.resources import MessageBasedResource


class StockClients:
    """Sessions of stock pyvisa-py with line feeds as terminators."""

    def __init__(self) -> None:
        self._opened: list[MessageBasedResource] = []

    def open(self, resource: str) -> MessageBasedResource:
        client = pyvisa.ResourceManager("@py").open_resource(resource, timeout=20_000)
        assert isinstance(client, MessageBasedResource)
        client.read_termination = client.write_termination = "\n"
        self._opened.append(client)
        return client

    def close(self) -> None:
        for client in self._opened:
            client.close()
