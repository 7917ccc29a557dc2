"""Numbers with their nouns."""


def count(number: int, thing: str) -> str:
    """Say how many there are of a thing: `1 route`, `2 routes`."""
    return f'{number} {thing}' if number == 1 else f'{number} {thing}s'
