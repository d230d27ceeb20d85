"""The thread that owns a wire, and what other threads hand to it."""

import threading

from drivers.wire import ServiceLoop


def test_what_is_posted_is_done_in_order_and_before_the_next_step():
    done = []
    loop = ServiceLoop("test", lambda: done.append("step"), lambda error: None)
    loop.post(lambda: done.append("first"))
    loop.post(lambda: done.append("second"))
    loop.turn()
    loop.turn()
    assert done == ["first", "second", "step", "step"]


def test_a_posted_command_that_fails_is_told_and_the_rest_goes_on():
    done, told = [], []
    loop = ServiceLoop("test", lambda: done.append("step"), told.append)
    loop.post(lambda: done[5])
    loop.post(lambda: done.append("after"))
    loop.turn()
    assert done == ["after", "step"]
    assert isinstance(told[0], IndexError)


def test_only_the_owner_touches_what_it_owns_whoever_posts():
    owners, table, ended = set(), {}, threading.Event()

    def step():
        owners.add(threading.get_ident())
        for key in table:  # a dictionary that somebody else changes meanwhile raises
            table[key] += 1

    loop = ServiceLoop("test", step, lambda error: ended.set())

    def ask(name):
        for i in range(2000):
            loop.post(lambda i=i: (owners.add(threading.get_ident()), table.update({(name, i): 0})))

    loop.start()
    askers = [threading.Thread(target=ask, args=(name,)) for name in "abcd"]
    for thread in askers:
        thread.start()
    for thread in askers:
        thread.join()
    settled = threading.Event()
    loop.post(settled.set)
    assert settled.wait(20.0)
    loop.close()
    assert len(owners) == 1
    assert len(table) == 8000
    assert not ended.is_set()
