# The package conduit_ring under the name of its C++ headers, for find_package(conduit_core).
get_filename_component(_conduit_core_here "${CMAKE_CURRENT_LIST_DIR}" REALPATH)
include("${_conduit_core_here}/../conduit_ring/conduit_ring-config.cmake")
unset(_conduit_core_here)
