"""Waits until a page has reached a state, in tests with a browser."""


def wait_until(tab, condition, seconds=20):
    """Wait until a JavaScript expression is true in a tab.

    `wait_for_function` of Playwright calls eval in the page, which the content policy of
    our pages forbids.
    """
    for _ in range(20 * seconds):
        if tab.evaluate(condition):
            return
        tab.wait_for_timeout(50)
    raise AssertionError(f"{condition} was not true within {seconds} s")
