"""Who looks at the page, and who has to go."""

from ros2_kafka_bridge.web.viewers import MOST, MOST_WITH_TOKEN, Viewer, Viewers


def _enter(
    viewers: Viewers, network: str, number: int, *, has_token: bool = False
) -> list[Viewer]:
    made = [Viewer(network, has_token=has_token) for _ in range(number)]
    for viewer in made:
        viewers.enter(viewer)
    return made


def test_all_behind_one_address_look_as_long_as_there_is_room() -> None:
    viewers = Viewers()
    assert not any(it.is_let_go for it in _enter(viewers, 'proxy', MOST))
    assert len(viewers) == MOST


def test_the_oldest_of_an_address_goes_and_nobody_else() -> None:
    viewers = Viewers()
    [operator] = _enter(viewers, 'operator', 1)
    many = _enter(viewers, 'stranger', 2 * MOST)
    assert not operator.is_let_go
    assert [it.is_let_go for it in many] == [True] * (MOST + 1) + [False] * (MOST - 1)
    assert len(viewers) == MOST


def test_where_all_is_full_it_is_one_of_those_who_have_most() -> None:
    viewers = Viewers()
    [operator] = _enter(viewers, 'operator', 1)
    crowds = [_enter(viewers, f'stranger {number}', 10) for number in range(8)]
    assert len(viewers) == MOST
    assert not operator.is_let_go
    assert all(any(not it.is_let_go for it in crowd) for crowd in crowds)
    [late] = _enter(viewers, 'late', 1)
    assert not late.is_let_go


def test_the_newest_is_never_let_go_though_all_are_strangers() -> None:
    viewers = Viewers()
    assert [_enter(viewers, f'{number}', 1)[0] for number in range(MOST)]
    [late] = _enter(viewers, 'late', 1)
    assert (late.is_let_go, len(viewers)) == (False, MOST)


def test_those_with_the_token_have_places_of_their_own() -> None:
    viewers = Viewers()
    [operator] = _enter(viewers, 'proxy', 1, has_token=True)
    strangers = _enter(viewers, 'proxy', MOST)
    assert not operator.is_let_go
    kept = [it for it in strangers if not it.is_let_go]
    _enter(viewers, 'proxy', MOST_WITH_TOKEN, has_token=True)
    assert operator.is_let_go
    assert not any(it.is_let_go for it in kept)


def test_who_leaves_makes_room_once() -> None:
    viewers = Viewers()
    made = _enter(viewers, 'a', MOST + 1)
    for viewer in made:
        viewers.leave(viewer)
    assert len(viewers) == 0
