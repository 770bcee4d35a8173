"""`spherekit completion`: what makes a shell complete the words of spherekit."""

import argparse

EXAMPLES = (
    ('eval "$(spherekit completion bash)"', "in this bash; in ~/.bashrc for every one"),
    ('eval "$(spherekit completion zsh)"', "in ~/.zshrc, after compinit"),
    ("spherekit completion fish | source", "in ~/.config/fish/config.fish"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="the shell")


def execute(options: argparse.Namespace) -> int:
    """Print the shell's code."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(["spherekit"], shell=options.shell))
    return 0
