"""What addresses may hold is masked in any text; what a person reads there besides is not."""

import pytest

from ros2_kafka_bridge.errors import BridgeError, ConfigError
from ros2_kafka_bridge.outside.masking import (
    finding,
    masked_address,
    masked_addresses,
    masked_query,
)


@pytest.mark.parametrize(
    ('text', 'shown'),
    [
        ('https://r/?api_key=sesame', 'https://r/?api_key=***'),
        ('HTTPS://R:8081/p?a=sesame&b=sesame', 'HTTPS://R:8081/p?a=***&b=***'),
        ('http://[::1]:8081/?k=sesame', 'http://[::1]:8081/?k=***'),
        ('http://u:sesame@[::1]:1/', 'http://***@[::1]:1/'),
        ('http://a/?x=sesame,https://b/?y=sesame', 'http://a/?x=***,https://b/?y=***'),
        ('http://a/?x=sesame, https://b, or', 'http://a/?x=***, https://b, or'),
        ('http://h/p;id=sesame', 'http://h/p;***'),
        ('http://h/p?b=1;c=sesame', 'http://h/p?b=***'),
        ('http://u:ses/ame@sesame@host/x?y=sesame', 'http://***@host/x?y=***'),
        ('http://u:sesame?sesame@host/x', 'http://***@host/x'),
        ('http://u:sesame#sesame@host/x', 'http://***@host/x'),
        ('http://h/?sesame', 'http://h/?***'),
        ('http://h/?c2VzYW1l==', 'http://h/?***'),
        ('http://h/?a=%73esame%26x', 'http://h/?a=***'),
        ('http://h/#/r?token=sesame', 'http://h/#***'),
        ('http://h/p?a=1#sesame', 'http://h/p?a=***#***'),
        ('https://h/t?user=a@b.c&p=sesame', 'https://h/t?user=***&p=***'),
        ('{"url":"http://h/?a=sesame","b":"c"}', '{"url":"http://h/?a=***","b":"c"}'),
        ("{'url': 'http://h/?a=sesame', 'x': 1}", "{'url': 'http://h/?a=***', 'x': 1}"),
        ('(http://h/t?a=sesame): gone.', '(http://h/t?a=***): gone.'),
        ('with url: /v1/traces?api_key=sesame (of it', 'with url: /v1/traces?api_key=*** (of it'),
        ('idp/token?s=sesame&next=https://x', 'idp/token?s=***&next=***'),
        ('jdbc:mysql://u:sesame@h/db?password=sesame', 'jdbc:mysql://***@h/db?password=***'),
    ],
)
def test_what_may_be_secret_in_an_address_is_masked(text: str, shown: str) -> None:
    assert masked_addresses(text) == shown
    assert masked_addresses(shown) == shown
    assert masked_addresses(f'see {text}\nnow') == f'see {shown}\nnow'


@pytest.mark.parametrize(
    'text',
    [
        'http://127.0.0.1:9464/metrics',
        'Schema Registry https://h:8081: does not answer: does url name a Schema Registry?',
        'PLAINTEXT://kafka:9092, SASL_SSL://other:1',
        'is it right? Then /a/b? http://h/?',
        'robot-{ros.gid} (did you mean x?)',
    ],
)
def test_all_else_stays_as_it_is(text: str) -> None:
    assert masked_addresses(text) == text


@pytest.mark.parametrize(
    ('value', 'shown'),
    [
        ('user:sesame@proxy:3128', '***@proxy:3128'),
        ('idp/token?client_secret=sesame', 'idp/token?client_secret=***'),
        ('https://h/t?a=ses ame', 'https://h/t?a=***'),
        ('https://u:ses ame@h/x', 'https://***@h/x'),
        ('https://h?b="sesame"', 'https://h?b=***'),
        ('http://a?x=sesame,\thttp://b?y=sesame.', 'http://a?x=***,\thttp://b?y=***'),
    ],
)
def test_a_value_that_is_an_address_is_one_to_its_end(value: str, shown: str) -> None:
    assert masked_address(value) == shown


def test_the_names_in_a_query_stay() -> None:
    assert masked_query('resource=api://x&&key=sesame&sesame') == 'resource=***&&key=***&***'


def test_no_error_shows_what_may_be_secret_in_an_address() -> None:
    text = 'https://u:sesame@h/?k=sesame'
    error = ConfigError([text, text])
    assert 'sesame' not in f'{error}{error!r}{error.problems}{BridgeError(text)}'


@pytest.mark.parametrize(
    'text',
    ['client what?ever', '$.a?b: unknown field', '/data/q?x.yaml:3: no such file', 'C:\\a?b\\c'],
)
def test_a_question_mark_makes_no_address(text: str) -> None:
    assert masked_addresses(text) == text


@pytest.mark.parametrize(
    'said',
    [
        'pa ss/wörd',
        'pa%20ss/w%C3%B6rd',
        'pa%20ss%2Fw%C3%B6rd',
        r'pa ss/w\u00f6rd',
        'bWU6cGEgc3Mvd8O2cmQ=',
    ],
)
def test_a_secret_is_found_in_each_spelling(said: str) -> None:
    found = finding(['pa ss/wörd'], ['me:pa ss/wörd'])
    assert found.sub('***', f'bad login: {said}!') == 'bad login: ***!'


def test_where_there_is_no_secret_none_is_found() -> None:
    assert finding(['', ''], [':', '']).sub('***', 'all of it') == 'all of it'
