"""From a machine file to a machine: ports, protocols, streams, and machines that are not there.

Nothing here loads JAX or an array library.
"""
