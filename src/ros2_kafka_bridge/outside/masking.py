"""What may be secret in an address is not shown: its user, its query, its fragment.

Settings hold addresses, and what others say of one of them (librdkafka, a registry, a collector)
quotes it: whatever the bridge shows goes by here.
"""

import json
import re
from base64 import b64encode
from collections.abc import Iterable, Mapping
from typing import Final
from urllib.parse import quote

MASK: Final = '***'
"""What stands for a secret."""

_SCHEME: Final = r'[A-Za-z][A-Za-z0-9+.-]{0,31}://'
_NEXT: Final = re.compile(rf',(?=\s*{_SCHEME})')
_BEGIN: Final = re.compile(rf'\s*(?:{_SCHEME})?')
# Libraries tell an address without its scheme and host, too.
_IN_TEXT: Final = re.compile(
    rf'(://|(?<=[\w/])\?(?=[\w.~%\[\]-]+=))((?:(?!{_NEXT.pattern})[^\s"<>])*)'
)
_HOST: Final = re.compile(r'(\[[^\]]*\]|[^:\[\]/]*)(:\d*)?(/.*)?', re.DOTALL)
# What has no value behind its =, as base64 ends, is perhaps no name but the secret.
_PARAMETER: Final = re.compile(r'([\w.~%\[\]-]+=)(?!=*$).*', re.DOTALL)
_PUNCTUATION: Final = ".,:;!?'`)]}\\"
_MARK: Final = re.compile(r'([?#;])')


def masked_addresses(text: str) -> str:
    """The same text, without what may be secret in the addresses that it names."""
    return _IN_TEXT.sub(_masked, text) if '://' in text or '?' in text else text


def masked_address(value: str) -> str:
    """The same of what is nothing but an address, or several with commas.

    Which part is secret nobody knows: the user is masked, each value in the query, the fragment,
    what a path has behind a semicolon. The path itself stays.
    """
    parts = []
    for part in _NEXT.split(value):
        begin = _BEGIN.match(part)
        scheme = begin[0] if begin else ''
        parts.append(scheme + _without_scheme(part.removeprefix(scheme)))
    return ','.join(parts)


def masked_setting(value: str) -> str:
    """The same of what may be an address: to its end if it begins like one, else a text."""
    is_address = re.match(rf'\s*{_SCHEME}', value) is not None
    return masked_address(value) if is_address else masked_addresses(value)


def masked_query(query: str) -> str:
    """The same of a query: the names in it stay."""
    return '&'.join(
        f'{found[1]}{MASK}' if (found := _PARAMETER.fullmatch(part)) else part and MASK
        for part in query.split('&')
    )


def finding(secrets: Iterable[str], logins: Iterable[str] = ()) -> re.Pattern[str]:
    """A pattern of secrets in each spelling in which somebody may say them again.

    Args:
        secrets: As they were written.
        logins: Each `user:password`, of which a client sends another spelling in a header.
    """
    found = {spelled for secret in secrets for spelled in _spellings(secret) if spelled}
    found |= {b64encode(login.encode()).decode() for login in logins if len(login) > 1}
    longest_first = sorted(found, key=len, reverse=True)
    return re.compile('|'.join(map(re.escape, longest_first)) or r'(?!)')


def login(properties: Mapping[str, object], of: str) -> str:
    """The `user:password` of an OAuth client, whose properties begin with `of`."""
    client, secret = (properties.get(f'{of}.client.{part}', '') for part in ('id', 'secret'))
    return f'{client}:{secret}'


def _spellings(secret: str) -> set[str]:
    escaped = (json.dumps(secret), json.dumps(secret, ensure_ascii=False))
    return {secret, quote(secret), quote(secret, ''), *(text[1:-1] for text in escaped)}


def _masked(found: re.Match[str]) -> str:
    start, rest = found.groups()
    address = rest.rstrip(_PUNCTUATION)  # the end of the sentence
    masked = masked_query(address) if start == '?' else _without_scheme(address)
    return f'{start}{masked}{rest[len(address) :]}'


def _without_scheme(address: str) -> str:
    place, mark, more = (*_MARK.split(address, maxsplit=1), '', '')[:3]
    # A password may hold what should be written as %2F, %3F or %40.
    if '@' in place or ('@' in more and not _HOST.fullmatch(place)):
        return f'{MASK}@{_without_scheme(address.rpartition("@")[2])}'
    if mark == '?':
        query, hash_mark, fragment = more.partition('#')
        return f'{place}?{masked_query(query)}{hash_mark}{fragment and MASK}'
    return f'{place}{mark}{more and MASK}'
