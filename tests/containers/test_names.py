"""Which name server is asked first."""

from tests.containers.names import with_first

ASKED = """search dns.podman
nameserver 10.89.0.1
nameserver 10.89.1.1
nameserver 192.0.2.53
options edns0
"""


def test_the_servers_of_other_networks_come_first_and_the_rest_stay_in_their_order() -> None:
    assert with_first(ASKED, {"10.89.1.1"}).splitlines() == [
        "search dns.podman",
        "options edns0",
        "nameserver 10.89.1.1",
        "nameserver 10.89.0.1",
        "nameserver 192.0.2.53",
    ]


def test_a_server_that_is_not_listed_is_not_added() -> None:
    assert sorted(with_first(ASKED, {"10.89.2.1"}).splitlines()) == sorted(ASKED.splitlines())
    assert with_first("", {"10.89.2.1"}) == ""
