# The rooms of the library and of the programs, and what each may include besides itself; libport/README.md has their
# sentences. The build takes its folders from here, tests/layout holds the includes against it.
set(rooms base tape replay loop port tty net taped catalog session blocking flexiport)
set(below_base)
set(below_tape base)
set(below_replay base tape)
set(below_loop base)
set(below_port base loop)
set(below_tty base loop port)
set(below_net base loop port)
set(below_taped base tape replay loop port)
set(below_catalog base tape loop port tty net taped)
set(below_session base loop port catalog)
set(below_blocking base loop port taped catalog)
set(below_flexiport base tape port taped catalog blocking)

set(below_tools base tape replay loop port taped catalog session)
set(below_daemon ${below_tools} net tools)
