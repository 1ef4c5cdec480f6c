"""Texts of several sentences."""


def followed_by(text: str, sentence: str) -> str:
    """Return a text and a sentence after it; a text that asks something needs no full stop."""
    end = '' if text.endswith(('.', '?', '!')) else '.'
    return f'{text}{end} {sentence}'
