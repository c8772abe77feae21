"""Inbox policies: which items of the inbox the person is shown, when, and on which lines."""
