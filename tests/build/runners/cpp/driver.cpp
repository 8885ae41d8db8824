#include "ask.hpp"

int main(int, char** argv) { return ask(argv[1], "ask\n") == "42\n" ? 0 : 1; }
