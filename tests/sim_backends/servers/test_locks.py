"""Who gets the lock."""

from sim_backends.servers.locks import LockAnswer, Locks


def test_one_alone() -> None:
    locks: Locks[str] = Locks()
    assert not locks.hold_off("b")
    assert locks.request("a", b"") == LockAnswer.SUCCESS
    assert locks.request("a", b"") == LockAnswer.ERROR
    assert locks.request("b", b"") == locks.request("b", b"word") == LockAnswer.FAILURE
    assert locks.hold_off("b")
    assert not locks.hold_off("a")
    assert locks.holders == 1
    assert locks.release("b") == LockAnswer.ERROR
    assert locks.release("a") == LockAnswer.SUCCESS
    assert locks.holders == 0


def test_several_with_one_word() -> None:
    locks: Locks[str] = Locks()
    assert locks.request("a", b"word") == locks.request("b", b"word") == LockAnswer.SUCCESS
    assert locks.request("c", b"other") == locks.request("a", b"") == LockAnswer.FAILURE
    assert locks.hold_off("c")
    assert not locks.hold_off("b")
    assert locks.release("a") == LockAnswer.SHARED_RELEASED
    assert locks.request("b", b"") == LockAnswer.SUCCESS
    assert locks.holders == 1
    assert locks.release("b") == LockAnswer.SUCCESS
    assert locks.release("b") == LockAnswer.SHARED_RELEASED
    assert locks.request("c", b"other") == LockAnswer.SUCCESS


def test_who_leaves_holds_nothing() -> None:
    locks: Locks[str] = Locks()
    locks.request("a", b"word")
    locks.request("a", b"")
    locks.forget("a")
    assert locks.holders == 0
    assert not locks.hold_off("b")
