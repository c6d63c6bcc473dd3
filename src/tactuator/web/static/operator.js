"use strict";
// The operator's page. The token is in the address after the #, and is sent to the page's own server only.
openOperator(location.hash.slice(1));
