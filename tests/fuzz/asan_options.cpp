// How a fuzzer runs under AddressSanitizer: stacks of allocations and freed memory kept short, which are half
// of what it costs, and one input's are enough.

extern "C" const char* __asan_default_options();
extern "C" const char* __asan_default_options() { return "malloc_context_size=6:quarantine_size_mb=8"; }
