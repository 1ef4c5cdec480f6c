"""`ground_link`: topics and services of the drone, offered on the ground over one connection.

In come topics and services of this host, and datagrams; out go the other host's.
"""
