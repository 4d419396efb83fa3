/* SPDX-License-Identifier: MIT */
/* The splitter of socketcand's text: from any reachable state, any character leads to a reachable state within the element. By
 * induction this holds for any stream of characters. */
#include "socketcand/text.c"

void check_text_feed(text_splitter_t splitter, char c)
{
    __CPROVER_assume(splitter.length <= TEXT_ELEMENT_MAX);
    bool whole = text_feed(&splitter, c);
    __CPROVER_assert(splitter.length <= TEXT_ELEMENT_MAX, "the element has room for its end");
    __CPROVER_assert(!whole || splitter.element[splitter.length] == '\0', "a whole element is a string");
}
