# The package conduit_ring of an installation, which may have been moved, for find_package().
get_filename_component(_conduit_ring_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
set(_conduit_ring_include_dir "${_conduit_ring_prefix}/include")
set(_conduit_ring_library_dir "${_conduit_ring_prefix}/lib")
include("${CMAKE_CURRENT_LIST_DIR}/conduit_ring-targets.cmake")
unset(_conduit_ring_prefix)
