#if defined(__STDC_VERSION__) && __STDC_VERSION__ > 201710L
#error "compiled as C23, where void (*f)() is a function without arguments"
#endif
